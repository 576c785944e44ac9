// SPDX-License-Identifier: Apache-2.0
/// Files and messages of the host, by ARM semihosting (ARM IHI 0095, sections 5 and 7).
#ifndef BV_PIL_SEMIHOST_HPP_
#define BV_PIL_SEMIHOST_HPP_

#include <cstdint>

namespace semihost
{

/// One request; the meaning of argument and result is the operation's.
inline std::int32_t call(std::uint32_t operation, const void *argument)
{
	register std::uint32_t r0 asm("r0") = operation;
	register const void *r1 asm("r1") = argument;

	asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
	return static_cast<std::int32_t>(r0);
}

enum class Mode : std::uint32_t {
	READ_BINARY = 1,
	WRITE_BINARY = 5,
};

/// A handle, or -1.
inline std::int32_t open(const char *name, std::uint32_t length, Mode mode)
{
	const std::uintptr_t block[] = {reinterpret_cast<std::uintptr_t>(name),
					static_cast<std::uintptr_t>(mode), length};

	return call(0x01, block);
}

inline bool close(std::int32_t handle)
{
	const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle)};

	return call(0x02, block) == 0;
}

inline void print(const char *text)
{
	call(0x04, text);
}

/// True when every byte was written.
inline bool write(std::int32_t handle, const void *from, std::uint32_t bytes)
{
	const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle),
					reinterpret_cast<std::uintptr_t>(from), bytes};

	return call(0x05, block) == 0;
}

/// True when every byte was there.
inline bool read(std::int32_t handle, void *to, std::uint32_t bytes)
{
	const std::uintptr_t block[] = {static_cast<std::uintptr_t>(handle),
					reinterpret_cast<std::uintptr_t>(to), bytes};

	return call(0x06, block) == 0;
}

[[noreturn]] inline void exit(int status)
{
	constexpr std::uintptr_t APPLICATION_EXIT = 0x20026;
	const std::uintptr_t block[] = {APPLICATION_EXIT, static_cast<std::uintptr_t>(status)};

	for (;;) {
		call(0x20, block);
	}
}

} // namespace semihost

#endif // BV_PIL_SEMIHOST_HPP_
