"""Files on disk: whole or not at all, checked before they are read, named safely."""
