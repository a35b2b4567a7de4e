// Loops that are unrolled before optimization. An array that is indexed by constants only is kept in registers,
// which loops unrolled by the optimizer do not achieve.
#pragma once

#include <utility>

#define INLINE [[gnu::always_inline]] static inline
#define INLINE_LAMBDA __attribute__((always_inline))

namespace bpn {

template <int I>
struct Index {
  static constexpr int value = I;
};

template <class Body, int... I>
INLINE void unrolled(Body body, std::integer_sequence<int, I...>) {
  (body(Index<I>{}), ...);
}

// Calls body(Index<0>{}), body(Index<1>{}), ... body(Index<Count - 1>{}).
template <int Count, class Body>
INLINE void unrolled(Body body) {
  unrolled(body, std::make_integer_sequence<int, Count>{});
}

}  // namespace bpn
