"""How far a reward can be trusted: held-out answers, support, alarms."""
