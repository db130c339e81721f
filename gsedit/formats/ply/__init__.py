"""The PLY family: any PLY, the .ply of 3D Gaussian Splatting, PlayCanvas' .compressed.ply."""
