"""The policy at the robot: the binarized network's kernels, the weight memory, the action sampling."""
