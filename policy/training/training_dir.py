"""What lies in the directory of a training."""

POLICY_NAME = "policy.pt"
CHECKPOINTS_NAME = "checkpoints"
SUMMARY_NAME = "summary.json"
"""What the last iteration measured."""
RESUME_NAME = "resume.pt"
"""The state that a killed training goes on from."""
