"""Any program as a 2D editor: it is given a folder of PNGs and must fill another."""
