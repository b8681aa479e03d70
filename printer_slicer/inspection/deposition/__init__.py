"""A height map of the plate, fed by moves of any source; unsupported extrusion, collisions, missing filament."""
