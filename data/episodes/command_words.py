"""What a robot is told to do, in the words of the labeling page and of reports."""

from __future__ import annotations


def words_of_command(command: tuple[float, float, float]) -> str:
    """Such as "forward 0.50 m/s, turning left 0.20 rad/s"; sideways and turning only
    where there is some of it.

    Args:
        command: Forward m/s, left m/s, yaw rad/s.
    """
    forward, left, yaw = command
    words = [f"{'forward' if forward >= 0 else 'backward'} {abs(forward):.2f} m/s"]
    if abs(left) >= 0.005:
        words.append(f"{'left' if left > 0 else 'right'} {abs(left):.2f} m/s")
    if abs(yaw) >= 0.005:
        words.append(f"turning {'left' if yaw > 0 else 'right'} {abs(yaw):.2f} rad/s")
    return ", ".join(words)
