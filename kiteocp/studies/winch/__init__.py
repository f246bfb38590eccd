"""To the winch: set points, phase switching and implementable laws of an optimal cycle."""
