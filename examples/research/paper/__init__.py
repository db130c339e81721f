"""The experiments of Efficient-NeRF2NeRF, repeated here: `python -m research.paper`."""
