"""Pictures of results (matplotlib, loaded on use)."""
