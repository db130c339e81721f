"""Views: datasets, cameras around a scene, sizes of pictures, and which views an edit needs."""
