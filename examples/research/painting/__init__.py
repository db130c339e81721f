"""The claims of Efficient-NeRF2NeRF, tried with a network that paints and contradicts itself."""
