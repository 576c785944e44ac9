/* SPDX-License-Identifier: Apache-2.0 */
#include "retained.h"

#include <string.h>

#include <zephyr/kernel.h>

#if defined(CONFIG_BOARD_NRF52_BSIM)

/* firmware/sim/retained.c, on the runner's side. */
uint8_t *hil_retained(void);

static uint8_t *kept(void)
{
	return hil_retained();
}

#else

static __noinit uint8_t no_init[RETAINED_SIZE];

static uint8_t *kept(void)
{
	return no_init;
}

#endif

void retained_get(uint8_t bytes[RETAINED_SIZE])
{
	memcpy(bytes, kept(), RETAINED_SIZE);
}

void retained_put(const uint8_t bytes[RETAINED_SIZE])
{
	memcpy(kept(), bytes, RETAINED_SIZE);
}
