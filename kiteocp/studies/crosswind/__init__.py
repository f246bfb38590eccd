"""The crosswind manoeuvre resolved in azimuth and elevation, against its representative state."""
