"""OpenUSD's ParticleField3DGaussianSplat: text by gsedit itself, binary files by usd-core."""
