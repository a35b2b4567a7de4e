"""What a real camera does to a picture, done to a simulated one."""
