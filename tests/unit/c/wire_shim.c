/* SPDX-License-Identifier: Apache-2.0 */
/* Gives the inline functions of wire.h, and a receiver with a callback, a linkable form. */
#include "framing.h"
#include "messages.h"

#ifdef __cplusplus
extern "C" {
#endif

#define EXPORT(name, NAME)                                                                         \
	size_t shim_##name##_put(uint8_t *buf, const struct wire_##name *m);                       \
	bool shim_##name##_get(struct wire_##name *m, const uint8_t *buf, size_t len);             \
	size_t shim_##name##_size(void);                                                           \
	unsigned int shim_##name##_id(void);                                                       \
                                                                                                   \
	size_t shim_##name##_put(uint8_t *buf, const struct wire_##name *m)                        \
	{                                                                                          \
		return wire_##name##_put(buf, m);                                                  \
	}                                                                                          \
	bool shim_##name##_get(struct wire_##name *m, const uint8_t *buf, size_t len)              \
	{                                                                                          \
		return wire_##name##_get(m, buf, len);                                             \
	}                                                                                          \
	size_t shim_##name##_size(void)                                                            \
	{                                                                                          \
		return sizeof(struct wire_##name);                                                 \
	}                                                                                          \
	unsigned int shim_##name##_id(void)                                                        \
	{                                                                                          \
		return WIRE_##NAME##_ID;                                                           \
	}

FOR_EACH_MESSAGE(EXPORT)

#define QUOTED(name, NAME) #name " "

const char *shim_message_names(void);
const char *shim_message_names(void)
{
	return FOR_EACH_MESSAGE(QUOTED);
}

uint64_t shim_schema_hash(void);
uint64_t shim_schema_hash(void)
{
	return WIRE_SCHEMA_HASH;
}

size_t shim_frame_max(size_t len);
size_t shim_frame_max(size_t len)
{
	return WIRE_FRAME_MAX(len);
}

typedef void (*shim_report)(uint8_t type, uint16_t seq, const uint8_t *payload, size_t len);

struct shim_counts {
	uint32_t frames;
	uint32_t rejected;
};

struct shim_counts shim_receive(const uint8_t *data, size_t len, shim_report report);
struct shim_counts shim_receive(const uint8_t *data, size_t len, shim_report report)
{
	struct wire_rx rx;
	struct shim_counts counts;

	memset(&rx, 0, sizeof(rx));
	for (size_t at = 0; at < len;) {
		bool good;

		at += wire_rx_take(&rx, data + at, len - at, &good);
		if (good) {
			report(rx.type, rx.seq, wire_rx_payload(&rx), rx.payload_len);
		}
	}
	counts.frames = rx.frames;
	counts.rejected = rx.rejected;
	return counts;
}

#ifdef __cplusplus
}
#endif
