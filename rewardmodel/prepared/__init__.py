"""Answers as a fit wants them: described, standardised and scaled once."""
