"""Settings of all tests."""

from __future__ import annotations

from hypothesis import settings

# A busy machine is no failure: how long one example takes is not what is tested.
settings.register_profile("gaitpref", deadline=None)
settings.load_profile("gaitpref")
