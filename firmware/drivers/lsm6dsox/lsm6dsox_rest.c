/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm6dsox_rest.h"

#include <stdlib.h>
#include <string.h>

void lsm6dsox_rest_reset(struct lsm6dsox_rest *r)
{
	r->calm = 0;
}

bool lsm6dsox_rest_push(struct lsm6dsox_rest *r, const struct lsm6dsox_pair *pair)
{
	bool is_calm = true;

	if (r->needed == 0U) {
		return false;
	}
	for (int i = 0; i < 3; i++) {
		is_calm = is_calm && abs(pair->gyro_lsb[i]) <= r->gyro_lsb;
		is_calm = is_calm &&
			  (r->calm == 0U ||
			   abs(pair->accel_lsb[i] - r->reference_lsb[i]) <= r->accel_lsb);
	}
	if (!is_calm) {
		r->calm = 0;
		return false;
	}
	if (r->calm == 0U) {
		memcpy(r->reference_lsb, pair->accel_lsb, sizeof(r->reference_lsb));
	}
	r->calm++;
	return r->calm >= r->needed;
}
