// SPDX-License-Identifier: Apache-2.0
/// How deep the stack has been: paint what is free, look later how much of the paint is left.
#ifndef BV_PIL_STACK_HPP_
#define BV_PIL_STACK_HPP_

#include <cstdint>

extern "C" std::uint32_t pil_stack_limit;

namespace pil_stack
{

constexpr std::uint32_t PAINT = 0xC0FFEE11;

inline std::uintptr_t pointer()
{
	std::uintptr_t sp;

	asm volatile("mov %0, sp" : "=r"(sp));
	return sp;
}

/// Everything from the limit up to `top`, which is the caller's own stack pointer.
[[gnu::always_inline]] inline void paint(std::uintptr_t top)
{
	volatile std::uint32_t *const end = reinterpret_cast<std::uint32_t *>(top);

	for (volatile std::uint32_t *word = &pil_stack_limit; word < end; word++) {
		*word = PAINT;
	}
}

/// Bytes below `top` that were used since they were painted.
inline std::uint32_t used(std::uintptr_t top)
{
	const volatile std::uint32_t *word = &pil_stack_limit;
	const volatile std::uint32_t *const end = reinterpret_cast<std::uint32_t *>(top);

	while (word < end && *word == PAINT) {
		word++;
	}
	return top - reinterpret_cast<std::uintptr_t>(word);
}

} // namespace pil_stack

#endif // BV_PIL_STACK_HPP_
