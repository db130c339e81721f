"""Photos or a video become posed photos: EXIF, frames, the upright frame, a picture of it."""
