/* SPDX-License-Identifier: Apache-2.0 */
#include "fail.h"

#include <zephyr/kernel.h>
#include <zephyr/sys/atomic.h>

#include "wire.h"

static atomic_t hangs;

#if defined(CONFIG_ARCH_POSIX)

/* Threads run on the host's stacks there; this is how the chip's memory protection ends it. */
static void overflow(void)
{
	z_except_reason(K_ERR_STACK_CHK_FAIL);
}

#else

static uint32_t fill(uint32_t depth)
{
	volatile uint8_t bytes[256];

	bytes[depth % sizeof(bytes)] = (uint8_t)depth;
	return depth == UINT32_MAX ? 0U : fill(depth + 1U) + bytes[0];
}

static void overflow(void)
{
	(void)fill(0);
}

#endif

int fail_command(uint8_t command)
{
	switch (command) {
	case WIRE_NODE_COMMAND_FAIL_FATAL:
		k_panic();
		return 0;
	case WIRE_NODE_COMMAND_FAIL_STACK:
		overflow();
		return 0;
	case WIRE_NODE_COMMAND_FAIL_HANG:
		atomic_set(&hangs, 1);
		return 0;
	default:
		return -EINVAL;
	}
}

void fail_if_told(enum watchdog_part part)
{
	while (part == WATCHDOG_SENSOR && atomic_get(&hangs) != 0) {
		k_busy_wait(1000);
	}
}
