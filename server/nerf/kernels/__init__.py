"""nerf/kernels"""
