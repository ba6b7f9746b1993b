"""What is to be seen: motions, the human they follow, and their bodies; no window, no file."""
