/* SPDX-License-Identifier: Apache-2.0 */
/* firmware/sim/pace.c with a clock that a test moves, and sleeps that end late. */
#define _POSIX_C_SOURCE 200809L
#include <stdint.h>
#include <time.h>

typedef uint64_t bs_time_t;
typedef struct {
	const char *option;
	const char *name;
	char type;
	void *dest;
	const char *descript;
} bs_args_struct_t;

#define TIME_NEVER                       UINT64_MAX
#define ARG_TABLE_ENDMARKER              {.option = 0}
#define NSI_HW_EVENT(timer, event, prio) void (*shim_event)(void) = event
#define NSI_TASK(task, level, prio)      void (*shim_##task)(void) = task

static double now_s;
static double late_s;

static void nsi_hws_find_next_event(void)
{
}

static void bs_add_extra_dynargs(bs_args_struct_t *options)
{
	*(double *)options[0].dest = 1.0;
}

static int shim_clock_gettime(clockid_t clock, struct timespec *now)
{
	(void)clock;
	now->tv_sec = (time_t)now_s;
	now->tv_nsec = (long)(1e9 * (now_s - (double)now->tv_sec));
	return 0;
}

static int shim_nanosleep(const struct timespec *rest, struct timespec *left)
{
	(void)left;
	now_s += (double)rest->tv_sec + 1e-9 * (double)rest->tv_nsec + late_s;
	return 0;
}

#define clock_gettime shim_clock_gettime
#define nanosleep     shim_nanosleep
#include "pace.c"

/* Wall time that `looks` take when each second one works burst_s more, and the run stands once. */
double shim_run(int looks, double work_s, double burst_s, double sleeps_late_s, double stands_s)
{
	now_s = 1000.0;
	late_s = sleeps_late_s;
	shim_pace_register_options();
	shim_pace_init();
	for (int n = 0; n < looks; n++) {
		now_s += work_s + (n % 2 != 0 ? burst_s : 0.0);
		now_s += n == looks / 2 ? stands_s : 0.0;
		shim_event();
	}
	return now_s - 1000.0;
}
