"""The `gsedit` command line: words in, words out."""
