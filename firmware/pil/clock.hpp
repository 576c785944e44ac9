// SPDX-License-Identifier: Apache-2.0
/// Virtual time, read from SysTick (ARMv7-M Architecture Reference Manual, B3.3).
///
/// The emulator lets each instruction take the same virtual time, a few ticks long, so a
/// difference of two readings tells the number of instructions between them exactly. The
/// counter has 24 bits and counts down.
#ifndef BV_PIL_CLOCK_HPP_
#define BV_PIL_CLOCK_HPP_

#include <cstdint>

namespace pil_clock
{

constexpr std::uint32_t MASK = 0xFFFFFF;

inline volatile std::uint32_t &reg(std::uintptr_t address)
{
	return *reinterpret_cast<volatile std::uint32_t *>(address);
}

inline void start()
{
	reg(0xE000E014) = MASK; // reload
	reg(0xE000E018) = 0;
	reg(0xE000E010) = 5; // processor clock, no interrupt, on
}

inline std::uint32_t now()
{
	return reg(0xE000E018);
}

inline std::uint32_t between(std::uint32_t begin, std::uint32_t end)
{
	return (begin - end) & MASK;
}

/// Ticks from a reading to the next one with Instructions - 1 others between them.
template <int Instructions> [[gnu::noinline]] std::uint32_t known()
{
	std::uint32_t begin, end;

	asm volatile("ldr %0, [%2]\n"
		     ".rept %c3\n"
		     "nop\n"
		     ".endr\n"
		     "ldr %1, [%2]\n"
		     : "=&r"(begin), "=&r"(end)
		     : "r"(0xE000E018), "i"(Instructions - 1));
	return between(begin, end);
}

} // namespace pil_clock

#endif // BV_PIL_CLOCK_HPP_
