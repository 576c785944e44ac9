// SPDX-License-Identifier: Apache-2.0
// From reset to main on a Cortex-M4F without an operating system.
#include <cstdint>

#include "semihost.hpp"

extern "C" {

extern std::uint32_t pil_stack_top;
extern std::uint32_t pil_data_start, pil_data_end, pil_bss_start, pil_bss_end;
extern const std::uint32_t pil_data_image;

int main();
[[noreturn]] void pil_reset();
[[noreturn]] void pil_fault();

using Handler = void (*)();

extern const Handler pil_vectors[];
[[gnu::section(".vectors"), gnu::used]] const Handler pil_vectors[] = {
	reinterpret_cast<Handler>(&pil_stack_top),
	pil_reset,
	pil_fault, // NMI
	pil_fault, // HardFault, and all that escalate to it
	pil_fault, // MemManage
	pil_fault, // BusFault
	pil_fault, // UsageFault
};

void pil_reset()
{
	// Full access to the FPU, CP10 and CP11, before any code that may touch it (ARMv7-M
	// Architecture Reference Manual, B3.2.20): a trapped instruction would only fault again.
	*reinterpret_cast<volatile std::uint32_t *>(0xE000ED88) |= 0xFu << 20;
	asm volatile("dsb\n isb" ::: "memory");

	const std::uint32_t *from = &pil_data_image;

	for (volatile std::uint32_t *to = &pil_data_start; to < &pil_data_end; to++) {
		*to = *from++;
	}
	for (volatile std::uint32_t *to = &pil_bss_start; to < &pil_bss_end; to++) {
		*to = 0;
	}
	semihost::exit(main());
}

void pil_fault()
{
	semihost::print("pil: the processor faulted\n");
	semihost::exit(1);
}

} // extern "C"
