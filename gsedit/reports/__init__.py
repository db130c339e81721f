"""What long work yields, and the files it leaves."""
