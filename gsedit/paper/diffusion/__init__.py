"""Diffusion sampling with consensus between views: any denoiser, schedule and solver.

A `Predictor` predicts; `levels_of` lists the noise levels to step between; `sample` yields the
latents after every step. Latents are [v c y x], `t` is a training step, x_t = a x0 + b noise.
"""
