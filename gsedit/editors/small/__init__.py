"""The learned editor: a small InstructPix2Pix, its training is in the model card."""
