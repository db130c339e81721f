"""Objects of a scene found by a click, a box, a mask or words; segments of a whole scene."""
