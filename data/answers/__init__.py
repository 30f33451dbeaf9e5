"""Pairs, answers and who gave them: records, and the store that never changes one."""
