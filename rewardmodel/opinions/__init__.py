"""What a person may want of a gait: habits, and curves of them.

`ranges` says where a step lies on what was recorded, `occupancy` where a clip is,
`opinions` which curves there are and how probable each is beforehand.
"""
