/* SPDX-License-Identifier: Apache-2.0 */
/* A flat interface to the decoder, so that ctypes needs no copy of its structures. */
#include <stdlib.h>

#include "lsm6dsox_decoder.h"

enum { BURST_FIELDS = 4, PAIR_FIELDS = 7, COUNTER_FIELDS = 12 };

struct lsm6dsox_decoder *shim_new(uint32_t first_slot)
{
	struct lsm6dsox_decoder *d = malloc(sizeof(*d));

	if (d != NULL) {
		lsm6dsox_decoder_init(d, first_slot);
	}
	return d;
}

void shim_free(struct lsm6dsox_decoder *d)
{
	free(d);
}

/* burst: pairs, words, mark_found, mark_slot; pairs: rows of slot, gyro x y z, accel x y z. */
int shim_push(struct lsm6dsox_decoder *d, const uint8_t *words, size_t size, size_t mark,
	      int64_t burst[BURST_FIELDS], int64_t *rows)
{
	struct lsm6dsox_pair *pairs = calloc(size / (2U * LSM6DSOX_WORD_SIZE) + 2U, sizeof(*pairs));
	struct lsm6dsox_burst found;

	if (pairs == NULL) {
		return -1;
	}
	found = lsm6dsox_decoder_push(d, words, size, mark, pairs);
	burst[0] = (int64_t)found.pairs;
	burst[1] = (int64_t)found.words;
	burst[2] = found.mark_found;
	burst[3] = found.mark_slot;
	for (size_t i = 0; i < found.pairs; i++) {
		int64_t *row = rows + i * PAIR_FIELDS;

		row[0] = pairs[i].slot;
		for (size_t axis = 0; axis < 3; axis++) {
			row[1 + axis] = pairs[i].gyro_lsb[axis];
			row[4 + axis] = pairs[i].accel_lsb[axis];
		}
	}
	free(pairs);
	return 0;
}

void shim_counters(const struct lsm6dsox_decoder *d, int64_t values[COUNTER_FIELDS])
{
	const struct lsm6dsox_decoder_counters *c = &d->counters;

	values[0] = c->words_paired;
	values[1] = c->words_unpaired;
	values[2] = c->words_out_of_sequence;
	values[3] = c->parity_errors;
	values[4] = c->unknown_tags;
	values[5] = c->config_changes;
	values[6] = c->words_other;
	values[7] = c->words_empty;
	values[8] = c->short_reads;
	values[9] = c->tag_gaps;
	values[10] = c->slots_lost;
	values[11] = c->pairs;
}
