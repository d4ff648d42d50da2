"""Readers and writers of calibration files: Velodyne's XML, the YAML of ROS, and our own CSV."""
