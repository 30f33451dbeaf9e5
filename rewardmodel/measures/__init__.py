"""How well a model foresees answers it has not seen."""
