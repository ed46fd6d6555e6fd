"""Tasks of manipulation in closed loop: demonstrations, rollouts, their videos and their page."""
