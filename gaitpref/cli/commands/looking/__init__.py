"""Commands that show what there is: policies, clips, rewards, runs."""
