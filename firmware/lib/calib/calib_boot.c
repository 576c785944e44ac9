/* SPDX-License-Identifier: Apache-2.0 */
#include "calib_boot.h"

#include <math.h>
#include <string.h>

#include "wire.h"

#define RADPS_PER_DPS 0.017453292519943295f
#define MPS2_PER_MG   9.80665e-3f

void calib_boot_restart(struct calib_boot *boot)
{
	const uint32_t attempts = boot->attempts;

	memset(boot, 0, sizeof(*boot));
	boot->attempts = attempts;
}

static void add(struct calib_boot *boot, uint64_t t_ticks, const float x[6])
{
	const bool first_half = t_ticks - boot->t_begin_ticks < CALIB_BOOT_WINDOW_TICKS / 2U;

	for (int i = 0; i < 6; i++) {
		const float d = x[i] - boot->origin[i];

		boot->sum[i] += d;
		boot->sum_squares[i] += d * d;
		if (first_half && i >= 3) {
			boot->sum_first[i - 3] += d;
		}
	}
	boot->count++;
	boot->count_first += first_half ? 1U : 0U;
}

static bool is_quiet(const struct calib_boot *boot, int axis, float std_max)
{
	const float n = (float)boot->count;
	const float mean = boot->sum[axis] / n;

	/* False for what is no number, too. */
	return boot->sum_squares[axis] / n - mean * mean < std_max * std_max;
}

static float norm(const float v[3])
{
	return sqrtf((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]);
}

/* How far the mean force moved from the first half of the window to the second. */
static float tilt_mps2(const struct calib_boot *boot)
{
	const float n_first = (float)boot->count_first;
	const float n_second = (float)(boot->count - boot->count_first);
	float moved[3];

	for (int i = 0; i < 3; i++) {
		moved[i] = (boot->sum[3 + i] - boot->sum_first[i]) / n_second -
			   boot->sum_first[i] / n_first;
	}
	return norm(moved);
}

static bool is_still(const struct calib_boot *boot)
{
	if (boot->count < CALIB_BOOT_SAMPLES_MIN) {
		return false;
	}
	for (int i = 0; i < 3; i++) {
		if (!is_quiet(boot, i, CALIB_BOOT_GYRO_STD_MAX_DPS * RADPS_PER_DPS) ||
		    !is_quiet(boot, 3 + i, CALIB_BOOT_ACCEL_STD_MAX_MG * MPS2_PER_MG)) {
			return false;
		}
	}
	return tilt_mps2(boot) < CALIB_BOOT_TILT_MAX_MG * MPS2_PER_MG;
}

static enum calib_boot_event end_window(struct calib_boot *boot)
{
	const bool still = is_still(boot);

	boot->attempts++;
	if (still) {
		for (int i = 0; i < 3; i++) {
			boot->gyro_bias_radps[i] =
				boot->origin[i] + boot->sum[i] / (float)boot->count;
		}
	}
	return still ? CALIB_BOOT_STILL : CALIB_BOOT_MOVED;
}

static void begin_window(struct calib_boot *boot, uint64_t t_ticks, const float x[6])
{
	boot->count = 0;
	boot->count_first = 0;
	boot->t_begin_ticks = t_ticks;
	memcpy(boot->origin, x, sizeof(boot->origin));
	memset(boot->sum, 0, sizeof(boot->sum));
	memset(boot->sum_squares, 0, sizeof(boot->sum_squares));
	memset(boot->sum_first, 0, sizeof(boot->sum_first));
}

enum calib_boot_event calib_boot_push(struct calib_boot *boot, uint64_t t_ticks,
				      const float gyro_radps[3], const float accel_mps2[3])
{
	const float x[6] = {gyro_radps[0], gyro_radps[1], gyro_radps[2],
			    accel_mps2[0], accel_mps2[1], accel_mps2[2]};
	enum calib_boot_event event = CALIB_BOOT_OPEN;

	/* A time before the last one is as large a gap as can be. */
	if (boot->count > 0U && t_ticks - boot->t_last_ticks > CALIB_BOOT_GAP_TICKS) {
		boot->count = 0;
	}
	if (boot->count > 0U && t_ticks - boot->t_begin_ticks >= CALIB_BOOT_WINDOW_TICKS) {
		event = end_window(boot);
		boot->count = 0;
	}
	if (boot->count == 0U) {
		begin_window(boot, t_ticks, x);
	}
	add(boot, t_ticks, x);
	boot->t_last_ticks = t_ticks;
	return event;
}

uint8_t calib_boot_decide(const float measured_radps[3], const float stored_radps[3],
			  float *delta_dps)
{
	float delta[3];

	for (int i = 0; i < 3; i++) {
		delta[i] = measured_radps[i] - stored_radps[i];
	}
	*delta_dps = norm(delta) / RADPS_PER_DPS;
	if (*delta_dps < CALIB_BOOT_WARN_DPS) {
		return WIRE_BOOT_CHECK_APPLIED;
	}
	return *delta_dps <= CALIB_BOOT_REFUSE_DPS ? WIRE_BOOT_CHECK_WARNED
						   : WIRE_BOOT_CHECK_REFUSED;
}
