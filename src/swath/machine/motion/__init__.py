"""Motion levels: how the machine moves under steering and speed."""
