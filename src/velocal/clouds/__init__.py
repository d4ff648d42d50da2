"""Clouds of points in files: PointCloud2 in bags, PCD, PLY, LAS, KITTI and our own Parquet."""
