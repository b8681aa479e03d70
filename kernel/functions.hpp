// The functions of the module; each is in a file of its own, which hatch_build.py compiles with kernel.cpp.

#ifndef PRINTER_SLICER_FUNCTIONS
#define PRINTER_SLICER_FUNCTIONS

#include "python.hpp"

PyObject* accumulate_with_limit(PyObject*, PyObject* arguments);    // limited_sums.cpp
PyObject* build_polyline_tree(PyObject*, PyObject* ends);           // polyline_tree.cpp
PyObject* clip_outlines(PyObject*, PyObject* arguments);            // outlines.cpp
PyObject* combine_areas(PyObject*, PyObject* arguments);            // clipping.cpp
PyObject* coordinate_keys(PyObject*, PyObject* arguments);          // keys.cpp
PyObject* cut_edges(PyObject*, PyObject* arguments);                // plane_sections.cpp
PyObject* divide_pieces(PyObject*, PyObject* arguments);            // divide_pieces.cpp
PyObject* facet_contacts(PyObject*, PyObject* arguments);           // contacts.cpp
PyObject* facing_boxes(PyObject*, PyObject* arguments);             // facing.cpp
PyObject* find_carried_samples(PyObject*, PyObject* arguments);     // bead_samples.cpp
PyObject* find_cycles(PyObject*, PyObject* following);              // plane_sections.cpp
PyObject* find_spikes(PyObject*, PyObject* arguments);              // spikes.cpp
PyObject* find_unsupported_pieces(PyObject*, PyObject* arguments);  // height_map.cpp
PyObject* format_move_rows(PyObject*, PyObject* arguments);         // move_rows.cpp
PyObject* highest_facets(PyObject*, PyObject* arguments);           // highest_facets.cpp
PyObject* inflate_paths(PyObject*, PyObject* arguments);            // inflating.cpp
PyObject* inner_edges(PyObject*, PyObject* arguments);              // inner_edges.cpp
PyObject* label_components(PyObject*, PyObject* arguments);         // keys.cpp
PyObject* make_blocks(PyObject*, PyObject* arguments);              // move_blocks.cpp
PyObject* match_edges(PyObject*, PyObject* arguments);              // keys.cpp
PyObject* miter_areas(PyObject*, PyObject* arguments);              // mitering.cpp
PyObject* nearest_marked(PyObject*, PyObject* arguments);           // nearest_marked.cpp
PyObject* nearest_segments(PyObject*, PyObject* arguments);         // polyline_tree.cpp
PyObject* neighbour_paths(PyObject*, PyObject* arguments);          // neighbour_paths.cpp
PyObject* neighbouring_boxes(PyObject*, PyObject* arguments);       // boxes.cpp
PyObject* number_cuts(PyObject*, PyObject* arguments);              // plane_sections.cpp
PyObject* outline_points(PyObject*, PyObject* arguments);           // outline_points.cpp
PyObject* overlapping_boxes(PyObject*, PyObject* arguments);        // boxes.cpp
PyObject* points_to_keep(PyObject*, PyObject* arguments);           // points_to_keep.cpp
PyObject* query_polyline_tree(PyObject*, PyObject* arguments);      // polyline_tree.cpp
PyObject* raise_height_map(PyObject*, PyObject* arguments);         // height_map.cpp
PyObject* read_elements(PyObject*, PyObject* arguments);            // element_runs.cpp
PyObject* remove_spikes(PyObject*, PyObject* arguments);            // spikes.cpp
PyObject* ring_areas(PyObject*, PyObject* arguments);               // spikes.cpp
PyObject* split_moves(PyObject*, PyObject* arguments);              // height_map.cpp
PyObject* voronoi_diagrams(PyObject*, PyObject* arguments);         // voronoi.cpp
PyObject* weld_keys(PyObject*, PyObject* keys);                     // keys.cpp

#endif
