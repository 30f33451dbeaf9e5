"""Why a reward likes a clip."""
