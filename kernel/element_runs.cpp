// The numbers of a run of XML elements in its usual form. All else is left to the twin, ElementRun.read.

#include <cstring>
#include <string_view>

#include "functions.hpp"

namespace {

constexpr double POWERS_OF_10[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                   1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
constexpr int LARGEST_POWER = 22;                // of those that are exact
constexpr std::uint64_t LARGEST_EXACT = 1ull << 53;  // all integers up to it are doubles
constexpr int MAX_DIGITS = 18;                   // that surely fit 64 bits

bool is_digit(char c) { return c >= '0' && c <= '9'; }

class Reader {
 public:
  explicit Reader(std::string_view text) : at_(text.data()), end_(text.data() + text.size()) {}

  bool is_at_end() const { return at_ == end_; }

  bool skip(std::string_view word) {
    if (static_cast<std::size_t>(end_ - at_) < word.size() || std::memcmp(at_, word.data(), word.size())) return false;
    at_ += word.size();
    return true;
  }

  // Skips white space, and returns whether there was any.
  bool skip_space() {
    const char* const first = at_;
    while (at_ < end_ && (*at_ == ' ' || *at_ == '\n' || *at_ == '\t' || *at_ == '\r')) ++at_;
    return at_ > first;
  }

  bool read(std::int64_t* value) {
    const bool is_negative = skip("-");
    const char* const first = at_;
    std::uint64_t digits = 0;
    read_digits(&digits);
    *value = is_negative ? -static_cast<std::int64_t>(digits) : static_cast<std::int64_t>(digits);
    return at_ > first && at_ - first <= MAX_DIGITS;
  }

  // A quotient or product of two exact doubles is the double nearest to the decimal number (Clinger 1990).
  bool read(double* value) {
    const char* const first = at_;
    const bool is_negative = skip("-");
    std::uint64_t digits = 0;
    int n_digits = read_digits(&digits), exponent = 0;
    if (skip(".")) {
      exponent = -read_digits(&digits);
      n_digits -= exponent;
    }
    if (!n_digits) return false;
    if ((skip("e") || skip("E")) && !add_exponent(&exponent)) return false;
    if (n_digits > MAX_DIGITS || digits > LARGEST_EXACT || exponent < -LARGEST_POWER || exponent > LARGEST_POWER)
      return read_rounded(first, value);
    *value = static_cast<double>(digits);
    if (exponent < 0)
      *value /= POWERS_OF_10[-exponent];
    else
      *value *= POWERS_OF_10[exponent];
    if (is_negative) *value = -*value;
    return true;
  }

 private:
  // Appends digits to a number, which overflows after MAX_DIGITS, and returns how many there were.
  int read_digits(std::uint64_t* number) {
    const char* const first = at_;
    for (; at_ < end_ && is_digit(*at_); ++at_) *number = *number * 10 + static_cast<std::uint64_t>(*at_ - '0');
    return static_cast<int>(at_ - first);
  }

  bool add_exponent(int* exponent) {
    const bool is_negative = skip("-");
    if (!is_negative) skip("+");
    std::uint64_t power = 0;
    const int n_digits = read_digits(&power);
    if (n_digits < 1 || n_digits > 4) return false;
    *exponent += is_negative ? -static_cast<int>(power) : static_cast<int>(power);
    return true;
  }

  // Lets Python round a number that ends here.
  bool read_rounded(const char* first, double* value) const {
    char* last = nullptr;
    *value = PyOS_string_to_double(first, &last, nullptr);
    if (!PyErr_Occurred()) return last == at_;
    PyErr_Clear();
    return false;
  }

  const char* at_;
  const char* end_;
};

// Words are the beginning of the tag, then what is before the number of each attribute.
template <typename Number>
bool read_elements(std::string_view text, const std::vector<std::string_view>& words, std::vector<Number>* numbers) {
  Reader reader(text);
  for (reader.skip_space(); !reader.is_at_end(); reader.skip_space()) {
    if (!reader.skip(words[0])) return false;
    for (std::size_t i = 1; i < words.size(); ++i) {
      Number number;
      if (!reader.skip_space() || !reader.skip(words[i]) || !reader.read(&number) || !reader.skip("\"")) return false;
      numbers->push_back(number);
    }
    reader.skip_space();
    if (!reader.skip("/>")) return false;
  }
  return true;
}

std::vector<std::string_view> split(std::string_view text) {
  std::vector<std::string_view> words;
  for (std::size_t end; (end = text.find(' ')) != text.npos; text.remove_prefix(end + 1))
    words.push_back(text.substr(0, end));
  words.push_back(text);
  return words;
}

template <typename Number>
PyObject* to_object(std::string_view text, std::string_view words) {
  std::vector<Number> numbers;
  try {
    if (!read_elements(text, split(words), &numbers)) Py_RETURN_NONE;
  } catch (const std::bad_alloc&) {
    return PyErr_NoMemory();
  }
  return to_bytes(numbers);
}

}  // namespace

PyObject* read_elements(PyObject*, PyObject* arguments) {
  PyObject *text, *words;  // objects of bytes end with a zero, where the conversion of a number stops
  int is_whole;
  if (!PyArg_ParseTuple(arguments, "SSp:read_elements", &text, &words, &is_whole)) return nullptr;
  const auto view = [](PyObject* bytes) {
    return std::string_view(PyBytes_AsString(bytes), static_cast<std::size_t>(PyBytes_Size(bytes)));
  };
  return is_whole ? to_object<std::int64_t>(view(text), view(words)) : to_object<double>(view(text), view(words));
}
