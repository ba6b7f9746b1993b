"""Motion clips: text files of several formats -> ten named joint positions per frame."""
