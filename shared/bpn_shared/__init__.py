"""What the services agree on; imports no service, no torch, no mujoco."""
