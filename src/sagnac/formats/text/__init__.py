"""Text: CSV, bare numbers, Xsens exports."""
