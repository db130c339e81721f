"""InstructPix2Pix weights in diffusers' layout: found, inspected, loaded, and run as a denoiser."""
