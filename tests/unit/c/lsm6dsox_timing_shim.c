/* SPDX-License-Identifier: Apache-2.0 */
/* A flat interface to the slot timing, so that ctypes needs no copy of its structures. */
#include <stdlib.h>

#include "lsm6dsox_timing.h"

struct lsm6dsox_timing *shim_new(double nominal_rate_hz, double edge_sigma_ticks)
{
	struct lsm6dsox_timing_params params = lsm6dsox_timing_defaults();
	struct lsm6dsox_timing *t = malloc(sizeof(*t));

	if (t != NULL) {
		params.edge_sigma_ticks = (float)edge_sigma_ticks;
		lsm6dsox_timing_init(t, &params, (float)nominal_rate_hz);
	}
	return t;
}

void shim_free(struct lsm6dsox_timing *t)
{
	free(t);
}

int shim_edge(struct lsm6dsox_timing *t, uint32_t slot, uint64_t ticks)
{
	return (int)lsm6dsox_timing_edge(t, slot, ticks);
}

double shim_period_ticks(const struct lsm6dsox_timing *t)
{
	return (double)t->period_q24 / 16777216.0;
}

double shim_sigma_ticks(const struct lsm6dsox_timing *t, uint32_t slot)
{
	return (double)lsm6dsox_timing_sigma_ticks(t, slot);
}
