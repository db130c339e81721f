"""How gsedit/words/words.safetensors was made; not part of the installed package."""
