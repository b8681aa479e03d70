// The module printer_slicer._kernel: functions that are faster in C++. Each has a twin in Python with equal results.
//
// hatch_build.py compiles it, without contraction of floating-point operations, because results depend on each rounding.

#include "clipper2/clipper.version.h"
#include "functions.hpp"

namespace {

constexpr int INTERFACE = 10;  // increase it with every change that callers or results notice, also in kernel.py

PyMethodDef methods[] = {
    {"accumulate_with_limit", accumulate_with_limit, METH_VARARGS, "Add with limits; see kernel.py."},
    {"build_polyline_tree", build_polyline_tree, METH_O, "Build a search tree for segments; see kernel.py."},
    {"clip_outlines", clip_outlines, METH_VARARGS, "Clip outlines to areas of layers; see kernel.py."},
    {"combine_areas", combine_areas, METH_VARARGS, "Combine areas of layers; see kernel.py."},
    {"coordinate_keys", coordinate_keys, METH_VARARGS, "Compute keys of corners; see kernel.py."},
    {"cut_edges", cut_edges, METH_VARARGS, "Cut edges by planes; see kernel.py."},
    {"divide_pieces", divide_pieces, METH_VARARGS, "Divide the pieces of a medial axis; see kernel.py."},
    {"facet_contacts", facet_contacts, METH_VARARGS, "Find what can touch a ball; see kernel.py."},
    {"facing_boxes", facing_boxes, METH_VARARGS, "Find sides that face each other; see kernel.py."},
    {"find_carried_samples", find_carried_samples, METH_VARARGS, "Find samples of beads that lie on others; see kernel.py."},
    {"find_cycles", find_cycles, METH_O, "Find the cycles of a permutation; see kernel.py."},
    {"find_spikes", find_spikes, METH_VARARGS, "Find spikes of outlines; see kernel.py."},
    {"find_unsupported_pieces", find_unsupported_pieces, METH_VARARGS, "Find unsupported extrusion; see kernel.py."},
    {"format_move_rows", format_move_rows, METH_VARARGS, "Format rows of moves; see kernel.py."},
    {"highest_facets", highest_facets, METH_VARARGS, "Find the highest facets over points; see kernel.py."},
    {"inflate_paths", inflate_paths, METH_VARARGS, "Offset outlines and lines; see kernel.py."},
    {"inner_edges", inner_edges, METH_VARARGS, "Find the edges of the medial axis; see kernel.py."},
    {"label_components", label_components, METH_VARARGS, "Label connected components; see kernel.py."},
    {"make_blocks", make_blocks, METH_VARARGS, "Build blocks of moves; see kernel.py."},
    {"match_edges", match_edges, METH_VARARGS, "Match the edges of facets; see kernel.py."},
    {"miter_areas", miter_areas, METH_VARARGS, "Move outlines with mitered corners; see kernel.py."},
    {"nearest_marked", nearest_marked, METH_VARARGS, "Find the nearest marked item along links; see kernel.py."},
    {"nearest_segments", nearest_segments, METH_VARARGS, "Find the segments nearest to points; see kernel.py."},
    {"neighbour_paths", neighbour_paths, METH_VARARGS, "Compute costs of paths with limits; see kernel.py."},
    {"neighbouring_boxes", neighbouring_boxes, METH_VARARGS, "Find boxes that overlap; see kernel.py."},
    {"number_cuts", number_cuts, METH_VARARGS, "Number the cuts of facets; see kernel.py."},
    {"outline_points", outline_points, METH_VARARGS, "Find the points that outlines need; see kernel.py."},
    {"overlapping_boxes", overlapping_boxes, METH_VARARGS, "Find boxes that overlap others; see kernel.py."},
    {"points_to_keep", points_to_keep, METH_VARARGS, "Find the points that paths need; see kernel.py."},
    {"query_polyline_tree", query_polyline_tree, METH_VARARGS, "Find the segments near boxes; see kernel.py."},
    {"raise_height_map", raise_height_map, METH_VARARGS, "Add extrusions to a height map; see kernel.py."},
    {"read_elements", read_elements, METH_VARARGS, "Read the numbers of XML elements; see kernel.py."},
    {"remove_spikes", remove_spikes, METH_VARARGS, "Remove spikes of outlines; see kernel.py."},
    {"ring_areas", ring_areas, METH_VARARGS, "Compute the areas of rings; see kernel.py."},
    {"split_moves", split_moves, METH_VARARGS, "Split moves into short pieces; see kernel.py."},
    {"voronoi_diagrams", voronoi_diagrams, METH_VARARGS, "Compute segment Voronoi diagrams; see kernel.py."},
    {"weld_keys", weld_keys, METH_O, "Number equal keys; see kernel.py."},
    {nullptr, nullptr, 0, nullptr},
};

int set_up(PyObject* module) {
  if (PyModule_AddStringConstant(module, "CLIPPER2_VERSION", CLIPPER2_VERSION)) return -1;
  return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE);
}

PyModuleDef_Slot slots[] = {
    {Py_mod_exec, reinterpret_cast<void*>(set_up)},
    {0, nullptr},
};

PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernel", nullptr, 0, methods, slots, nullptr, nullptr, nullptr,
};

}  // namespace

PyMODINIT_FUNC PyInit__kernel() { return PyModuleDef_Init(&definition); }
