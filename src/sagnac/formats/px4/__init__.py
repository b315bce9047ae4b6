"""Logs of PX4 (ULog): raw samples of accelerometers and gyros."""
