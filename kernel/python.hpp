// What functions of the kernel share: arguments and results as arrays of bytes, and exceptions of Python.

#ifndef PRINTER_SLICER_PYTHON
#define PRINTER_SLICER_PYTHON

#define PY_SSIZE_T_CLEAN
#ifndef Py_LIMITED_API
#define Py_LIMITED_API 0x030B0000  // CPython 3.11 and later
#endif
#include <Python.h>

#include <cstddef>
#include <cstdint>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

// Input that is not what a function expects; it becomes a ValueError.
struct Invalid {
  const char* message;
};

// Elements of a type in an object with the buffer protocol; of a type without const, they can be written.
template <typename T>
class Elements {
 public:
  // After an exception, as of the elements before, these are not valid either.
  explicit Elements(PyObject* object) {
    constexpr int flags = std::is_const_v<T> ? PyBUF_SIMPLE : PyBUF_WRITABLE;
    valid_ = !PyErr_Occurred() && !PyObject_GetBuffer(object, &view_, flags);
  }
  ~Elements() {
    if (valid_) PyBuffer_Release(&view_);
  }
  Elements(const Elements&) = delete;
  Elements& operator=(const Elements&) = delete;

  bool valid() const { return valid_; }
  bool is_whole() const {
    return view_.len % sizeof(T) == 0 && reinterpret_cast<std::uintptr_t>(view_.buf) % sizeof(T) == 0;
  }
  std::size_t size() const { return static_cast<std::size_t>(view_.len) / sizeof(T); }
  T* data() const { return static_cast<T*>(view_.buf); }

 private:
  Py_buffer view_;
  bool valid_;
};

// Numbers of 8 bytes.
class Numbers : public Elements<const std::int64_t> {
 public:
  using Elements::Elements;
  const double* doubles() const { return reinterpret_cast<const double*>(data()); }
};

template <typename T>
PyObject* to_bytes(const std::vector<T>& values) {
  return PyBytes_FromStringAndSize(reinterpret_cast<const char*>(values.data()),
                                   static_cast<Py_ssize_t>(values.size() * sizeof(T)));
}

// Releases the memory of an array that is moved.
template <typename T>
PyObject* to_bytes(std::vector<T>&& values) {
  const std::vector<T> released = std::move(values);
  return to_bytes(released);
}

// Returns a tuple of one object of bytes per array.
template <typename... Arrays>
PyObject* to_tuple(Arrays&&... arrays) {
  PyObject* result = PyTuple_New(sizeof...(arrays));
  Py_ssize_t place = 0;
  const auto append = [&](PyObject* part) {
    if (result && (!part || PyTuple_SetItem(result, place++, part))) {
      Py_DECREF(result);
      result = nullptr;
    } else if (!result) {
      Py_XDECREF(part);
    }
  };
  (append(to_bytes(std::forward<Arrays>(arrays))), ...);
  return result;
}

// Runs code that uses nothing of Python, without the GIL; returns whether it succeeded. If not, an exception is set.
template <typename Code>
bool run(const Code& code) {
  PyObject* error = nullptr;
  const char* message = "";
  PyThreadState* state = PyEval_SaveThread();
  try {
    code();
  } catch (const Invalid& invalid) {
    error = PyExc_ValueError;
    message = invalid.message;
  } catch (const std::bad_alloc&) {
    error = PyExc_MemoryError;
  } catch (...) {
    error = PyExc_RuntimeError;
    message = "the kernel failed";
  }
  PyEval_RestoreThread(state);
  if (error) PyErr_SetString(error, message);
  return !error;
}

#endif
