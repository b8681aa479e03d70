// Memory for many small objects of one type, which is used again after they are deleted.

#ifndef PRINTER_SLICER_POOL
#define PRINTER_SLICER_POOL

#include <cstddef>
#include <memory>
#include <vector>

// Base class of such types; no type may derive from them. Each thread keeps its memory until it ends.
template <typename T>
class Pooled {
 public:
  static void* operator new(std::size_t) {
    Pool& pool = own();
    if (!pool.free) pool.grow();
    Slot* const slot = pool.free;
    pool.free = slot->next;
    return slot;
  }
  static void operator delete(void* object) {
    Pool& pool = own();
    Slot* const slot = static_cast<Slot*>(object);
    slot->next = pool.free;
    pool.free = slot;
  }

 private:
  static constexpr std::size_t SLOTS = 256;  // that are allocated at once

  union Slot {
    Slot* next;
    alignas(T) unsigned char object[sizeof(T)];
  };

  struct Pool {
    Slot* free = nullptr;
    std::vector<std::unique_ptr<Slot[]>> blocks;

    void grow() {
      blocks.emplace_back(new Slot[SLOTS]);
      for (std::size_t i = SLOTS; i-- > 0; free = &blocks.back()[i]) blocks.back()[i].next = free;
    }
  };

  static Pool& own() {
    thread_local Pool pool;
    return pool;
  }
};

#endif
