/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Holds the simulation to a pace, for a person who takes part in it.
 *
 *   -hil_speed=X    at most X times as fast as real time; 0, the default, as fast as it goes
 */
#include "bs_cmd_line.h"
#include "bs_dynargs.h"
#include "bs_types.h"
#include "nsi_hw_scheduler.h"
#include "nsi_hws_models_if.h"
#include "nsi_tasks.h"

#include <math.h>
#include <time.h>

#define LOOK_PERIOD_US 5000
/* Work in bursts and sleeps that end late are made up for; what the reader takes longer is not. */
#define MADE_UP_S      0.1

static double speed;
static double origin_s;
static bs_time_t pace_timer = TIME_NEVER;

static double wall_s(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void pace_event(void)
{
	const double due_s = origin_s + 1e-6 * (double)pace_timer / speed;
	const double ahead_s = due_s - wall_s();

	if (ahead_s > 0.0) {
		const struct timespec rest = {
			.tv_sec = (time_t)ahead_s,
			.tv_nsec = (long)(1e9 * (ahead_s - floor(ahead_s))),
		};

		nanosleep(&rest, NULL);
	} else if (ahead_s < -MADE_UP_S) {
		origin_s -= ahead_s + MADE_UP_S;
	}
	pace_timer += LOOK_PERIOD_US;
	nsi_hws_find_next_event();
}

NSI_HW_EVENT(pace_timer, pace_event, 950);

static void pace_init(void)
{
	/* An option that was not given is NAN. */
	if (speed > 0.0) {
		origin_s = wall_s();
		pace_timer = LOOK_PERIOD_US;
		nsi_hws_find_next_event();
	}
}

NSI_TASK(pace_init, HW_INIT, 100);

static void pace_register_options(void)
{
	static bs_args_struct_t options[] = {
		{
			.option = "hil_speed",
			.name = "X",
			.type = 'f',
			.dest = (void *)&speed,
			.descript = "At most so many times as fast as real time",
		},
		ARG_TABLE_ENDMARKER,
	};

	bs_add_extra_dynargs(options);
}

NSI_TASK(pace_register_options, PRE_BOOT_1, 200);
