"""A reward linear in descriptors: mode, evidence, and how often answers err."""
