/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A crystal whose frequency wanders, for the simulated board.
 *
 *   local(t) = stock(t) + x(t)      stock(t) = t (1 + drift) - start_offset, x(t) as in wander.h
 *
 * The linker's --wrap puts these functions around the stock ones, so that the stock options
 * -xo_drift and -start_offset keep their meaning. Times are long double seconds, as in the stock
 * interface: its 64 bit mantissa holds an hour to better than a femtosecond.
 */
#include "bs_cmd_line.h"
#include "bs_dynargs.h"
#include "bs_tracing.h"
#include "bs_types.h"
#include "nsi_tasks.h"

#include <math.h>

#include "wander.h"

/* Far below the simulator's grid of 1 us, far above the rounding of long double. */
#define INVERSE_TOLERANCE_S 1e-13L

/* Each round gains a factor of at least 1 / WANDER_MAX_AMPLITUDE. */
#define INVERSE_MAX_ROUNDS 10

long double __real_dev_time_from_phy(long double true_s);
long double __real_phy_time_from_dev(long double local_s);

static struct wander wander;

long double __wrap_dev_time_from_phy(long double true_s)
{
	return __real_dev_time_from_phy(true_s) + wander_time_error_s(&wander, true_s);
}

long double __wrap_phy_time_from_dev(long double local_s)
{
	long double true_s = __real_phy_time_from_dev(local_s);

	for (int round = 0; wander.count > 0 && round < INVERSE_MAX_ROUNDS; round++) {
		const long double next_s = __real_phy_time_from_dev(
			local_s - wander_time_error_s(&wander, true_s));
		const bool converged = fabsl(next_s - true_s) < INVERSE_TOLERANCE_S;

		true_s = next_s;
		if (converged) {
			break;
		}
	}
	return true_s;
}

static char *wander_text;

static void wander_found(char *argv, int offset)
{
	(void)offset;
	const char *problem = wander_parse(&wander, wander_text);

	if (problem != NULL) {
		bs_trace_error_line("%s: %s\n", argv, problem);
	}
}

static void xo_wander_register_options(void)
{
	static bs_args_struct_t options[] = {
		{
			.option = "xo_wander",
			.name = "A:T:P[,A:T:P...]",
			.type = 's',
			.dest = (void *)&wander_text,
			.call_when_found = wander_found,
			.descript = "Sinusoidal frequency wander of the crystal, added to -xo_drift: "
				    "amplitude (1), period (s), phase (rad) of each term",
		},
		ARG_TABLE_ENDMARKER,
	};

	bs_add_extra_dynargs(options);
}

NSI_TASK(xo_wander_register_options, PRE_BOOT_1, 200);
