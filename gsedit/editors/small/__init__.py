"""The learned editor: a small InstructPix2Pix, trained by examples/research/train_small."""
