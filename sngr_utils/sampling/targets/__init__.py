"""What is sampled: the likelihood of a window, a landmark, a window with associations, a place."""
