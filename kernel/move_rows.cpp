// Rows of text of moves: the text that _format_rows in gcode/move_text.py returns, one row after the other.

#include "functions.hpp"

namespace {

constexpr std::size_t MOST_DIGITS = 20;  // of 64 bits

class Text {
 public:
  std::size_t size() const { return text_.size(); }
  const std::vector<char>& characters() const { return text_; }
  void append(char letter) { text_.push_back(letter); }

  // Appends a number in units of its last decimal, without trailing zeros of the decimals.
  void append(std::int64_t value, std::size_t decimals) {
    char digits[MOST_DIGITS];
    std::size_t n = 0;
    std::uint64_t rest = value < 0 ? 0 - static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value);
    if (value < 0) append('-');
    for (; rest || n <= decimals; rest /= 10) digits[n++] = static_cast<char>('0' + rest % 10);  // the last one first
    std::size_t end = 0;
    while (end < decimals && digits[end] == '0') ++end;
    while (n > decimals) append(digits[--n]);
    if (end < decimals) append('.');
    while (n > end) append(digits[--n]);
  }

 private:
  std::vector<char> text_;
};

// Characters in an object of bytes or an array of single bytes.
class Letters {
 public:
  explicit Letters(PyObject* object) { valid_ = !PyObject_GetBuffer(object, &view_, PyBUF_SIMPLE); }
  ~Letters() {
    if (valid_) PyBuffer_Release(&view_);
  }
  Letters(const Letters&) = delete;
  Letters& operator=(const Letters&) = delete;

  bool valid() const { return valid_; }
  std::size_t size() const { return static_cast<std::size_t>(view_.len); }
  std::uint8_t operator[](std::size_t i) const { return static_cast<const std::uint8_t*>(view_.buf)[i]; }

 private:
  Py_buffer view_;
  bool valid_;
};

}  // namespace

PyObject* format_move_rows(PyObject*, PyObject* arguments) {
  PyObject *codes_object, *words_object, *values_object, *present_object;
  if (!PyArg_ParseTuple(arguments, "OOOO:format_move_rows", &codes_object, &words_object, &values_object,
                        &present_object))
    return nullptr;
  Letters codes(codes_object);
  if (!codes.valid()) return nullptr;
  Letters words(words_object);
  if (!words.valid()) return nullptr;
  Numbers values(values_object);
  if (!values.valid()) return nullptr;
  Letters present(present_object);
  if (!present.valid()) return nullptr;
  Text text;
  std::vector<std::int64_t> lengths;
  const bool succeeded = run([&] {
    const std::size_t n_rows = codes.size(), n_words = words.size() / 2;
    if (words.size() % 2 || !values.is_whole() || values.size() != n_rows * n_words || present.size() != values.size())
      throw Invalid{"the numbers of words do not match the rows"};
    for (std::size_t word = 0; word < n_words; ++word)
      if (words[2 * word + 1] >= MOST_DIGITS) throw Invalid{"too many decimals"};
    for (std::size_t row = 0; row < n_rows; ++row) {
      const std::size_t before = text.size();
      text.append('G');
      text.append(static_cast<char>('0' + codes[row]));
      for (std::size_t word = 0, at = row; word < n_words; ++word, at += n_rows) {
        if (!present[at]) continue;
        text.append(' ');
        text.append(static_cast<char>(words[2 * word]));
        text.append(values.data()[at], words[2 * word + 1]);
      }
      text.append('\n');
      lengths.push_back(static_cast<std::int64_t>(text.size() - before));
    }
  });
  return succeeded ? to_tuple(text.characters(), lengths) : nullptr;
}
