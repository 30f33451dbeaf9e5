"""Episodes out of ROS 2 bags, so that hardware is judged beside simulation."""

from .unpacking import bound_chunks

bound_chunks()
