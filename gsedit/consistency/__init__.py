"""What views of one scene have in common: correspondences, consensus, shared noise."""
