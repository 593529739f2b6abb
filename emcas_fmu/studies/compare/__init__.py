"""Parameter sets or actuators side by side, judged by the same requirements."""
