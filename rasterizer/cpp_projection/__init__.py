"""From a scene to what is blended, and back, compiled. preprocess.py, project.py, harmonics.py and
tiles.py are its definition, and its fallback."""
