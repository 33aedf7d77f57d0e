"""The ray kernel in Warp: one source for CPU and CUDA. Imported only when rays are cast."""
