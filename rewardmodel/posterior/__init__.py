"""A wish as one to three habits, each with a curve; what answers leave probable of it.

`ranges` says where a step lies on what was recorded, `occupancy` where a clip is,
`opinions` which curves there are and how probable each is beforehand, `sampler` what
answers make of that, `information` which question would tell most, `scorer` what is
paid.
"""
