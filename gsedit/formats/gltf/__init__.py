"""glTF with KHR_gaussian_splatting: its document and its splats."""
