"""Record where a print extrudes, and find unsupported extrusion, collisions and missing extrusion."""
