"""Navigation: where a unit goes, and where it finds itself from its own samples."""
