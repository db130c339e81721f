"""Photos or a video become posed photos and, fitted to them, a scene: EXIF, frames, stages."""
