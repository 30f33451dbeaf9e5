"""How much one visitor may ask of the page."""
