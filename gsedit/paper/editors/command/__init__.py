"""Any program as a 2D editor: it is given a folder of PNGs and must fill another."""

EXAMPLE = '--run "my_editor {input} {output} {prompt}"'
MASK_EXAMPLE = '--masks-run "my_segmenter {input} {output} {phrase}"'
