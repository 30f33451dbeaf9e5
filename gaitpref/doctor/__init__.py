"""What a machine has of all that gaitpref can use, and what to do about the rest."""
