"""Record where moves extrude, and find unsupported extrusion, collisions and missing filament."""
