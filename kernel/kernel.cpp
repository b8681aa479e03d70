// The module printer_slicer._kernel: functions that are faster in C++. Each has a twin in Python with equal results.
//
// hatch_build.py compiles it, without contraction of floating-point operations, because results depend on each rounding.

#include "functions.hpp"

namespace {

constexpr int INTERFACE = 2;  // increase it with every change that callers or results notice, also in kernel.py

PyMethodDef methods[] = {
    {"facing_boxes", facing_boxes, METH_VARARGS, "Find sides that face each other; see kernel.py."},
    {"voronoi_diagrams", voronoi_diagrams, METH_VARARGS, "Compute segment Voronoi diagrams; see kernel.py."},
    {nullptr, nullptr, 0, nullptr},
};

int set_up(PyObject* module) { return PyModule_AddIntConstant(module, "INTERFACE", INTERFACE); }

PyModuleDef_Slot slots[] = {
    {Py_mod_exec, reinterpret_cast<void*>(set_up)},
    {0, nullptr},
};

PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernel", nullptr, 0, methods, slots, nullptr, nullptr, nullptr,
};

}  // namespace

PyMODINIT_FUNC PyInit__kernel() { return PyModuleDef_Init(&definition); }
