"""From numbers to words, for any study; nothing here knows of kites."""
