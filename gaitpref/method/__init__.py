"""The method: every decision of the loop as an object, and the two that ship.

Nothing here opens a file, a data base or a console: a decision is a function of what it
was made with, of the round's context and of the model.
"""
