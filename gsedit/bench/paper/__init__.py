"""The experiments of Efficient-NeRF2NeRF, repeated here: `gsedit bench paper`."""
