"""Agreement between views of one scene: correspondences, consensus, shared noise, harmonising."""
