/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Finds the leader's own capture of the event that the follower reports. Pure C11.
 */
#ifndef BV_SYNC_PAIRING_H_
#define BV_SYNC_PAIRING_H_

#include <stdbool.h>
#include <stdint.h>

#include "sync_event.h"
#include "sync_math.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Own captures remembered: 0.96 s at 7.5 ms. A report that comes later finds nothing. */
#define SYNC_PAIRING_DEPTH 128U

/** State. Zero-initialise once, then reset at each connection. */
struct sync_pairing {
	struct sync_capture own[SYNC_PAIRING_DEPTH];
	bool valid[SYNC_PAIRING_DEPTH];
	/** Reports for which there was no own capture. */
	uint32_t unmatched;
};

/** Forget the captures of an earlier connection, whose event numbers will come again. */
void sync_pairing_reset(struct sync_pairing *pairing);

/** Remember the leader's own capture. */
void sync_pairing_own(struct sync_pairing *pairing, const struct sync_capture *own);

/** @return true and the pair when the follower's capture @p peer has its counterpart. */
bool sync_pairing_match(struct sync_pairing *pairing, const struct sync_capture *peer,
			struct sync_pair *pair);

#ifdef __cplusplus
}
#endif

#endif /* BV_SYNC_PAIRING_H_ */
