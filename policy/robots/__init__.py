"""The robot that ships, and how the parts of any quadruped are told apart."""
