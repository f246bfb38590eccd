"""Optimal control problems of several phases: declaration, transcription, solution. Nothing here knows of kites."""
