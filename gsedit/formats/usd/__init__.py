"""OpenUSD's ParticleField3DGaussianSplat, read and written by usd-core in a child process."""
