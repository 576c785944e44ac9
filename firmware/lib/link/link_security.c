/* SPDX-License-Identifier: Apache-2.0 */
#include "link_security.h"

#include <errno.h>
#include <string.h>

#include <zephyr/kernel.h>
#include <zephyr/sys/atomic.h>
#include <zephyr/sys/byteorder.h>
#include <zephyr/sys/util.h>

#include "calib_store.h"
#include "diag_report.h"
#include "diag_uart.h"
#include "sync_timer.h"

/* Half a second over a good channel. */
#define PROOF_TIMEOUT K_SECONDS(3)

BUILD_ASSERT(sizeof(CONFIG_BV_LINK_KEY) == 2U * LINK_KEY_SIZE + 1U,
	     "BV_LINK_KEY: 32 hexadecimal digits");

/* In the order of the digits, which is that of an AES key. */
static uint8_t key[LINK_KEY_SIZE];
static struct k_spinlock key_lock;
static atomic_t key_known;
static atomic_t key_is_stored;

static atomic_t proved;
static atomic_t refused;
static K_SEM_DEFINE(ended, 0, 1);

static void set_key(const uint8_t bytes[LINK_KEY_SIZE], bool is_stored)
{
	const k_spinlock_key_t lock = k_spin_lock(&key_lock);

	memcpy(key, bytes, sizeof(key));
	k_spin_unlock(&key_lock, lock);
	atomic_set(&key_is_stored, is_stored ? 1 : 0);
}

static int set_key_of_image(void)
{
	uint8_t bytes[LINK_KEY_SIZE];

	if (hex2bin(CONFIG_BV_LINK_KEY, 2U * LINK_KEY_SIZE, bytes, sizeof(bytes)) !=
	    sizeof(bytes)) {
		return -EINVAL;
	}
	set_key(bytes, false);
	return 0;
}

int link_security_init(void)
{
	uint8_t bytes[LINK_KEY_SIZE];
	int err = calib_store_get_key(bytes);

	if (!err) {
		set_key(bytes, true);
	} else if (err == -ENOENT || err == -ENOTSUP) {
		err = set_key_of_image();
	}
	/* A store that cannot be read may have held one: better no peer than any. */
	atomic_set(&key_known, err == 0 ? 1 : 0);
	return err;
}

int link_security_take_key(const struct wire_link_key *message)
{
	static const uint8_t none[LINK_KEY_SIZE];
	const bool forget = memcmp(message->key, none, sizeof(none)) == 0;
	int err;

	if (!atomic_get(&key_known)) {
		return -EAGAIN;
	}
	err = calib_store_put_key(forget ? NULL : message->key);
	if (err) {
		return err;
	}
	if (forget) {
		return set_key_of_image();
	}
	set_key(message->key, true);
	return 0;
}

/* --- the host stack's questions -------------------------------------------------------------- */

static void on_key_asked(struct bt_conn *conn, struct bt_conn_oob_info *info)
{
	uint8_t bytes[LINK_KEY_SIZE];
	k_spinlock_key_t lock;

	if (info->type != BT_CONN_OOB_LE_LEGACY || !atomic_get(&key_known)) {
		(void)bt_conn_auth_cancel(conn);
		return;
	}
	lock = k_spin_lock(&key_lock);
	/* The stack keeps keys low byte first. */
	sys_memcpy_swap(bytes, key, sizeof(bytes));
	k_spin_unlock(&key_lock, lock);
	(void)bt_le_oob_set_legacy_tk(conn, bytes);
}

static void on_cancel(struct bt_conn *conn)
{
	ARG_UNUSED(conn);
}

static const struct bt_conn_auth_cb questions = {
	.oob_data_request = on_key_asked,
	.cancel = on_cancel,
};

int link_security_enable(void)
{
	bt_le_oob_set_legacy_flag(true);
	return bt_conn_auth_cb_register(&questions);
}

/* --- the connection -------------------------------------------------------------------------- */

static void on_connected(struct bt_conn *conn, uint8_t error)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(error);
	atomic_clear(&proved);
	k_sem_reset(&ended);
}

static void on_security(struct bt_conn *conn, bt_security_t level, enum bt_security_err error)
{
	ARG_UNUSED(conn);
	atomic_set(&proved, error == BT_SECURITY_ERR_SUCCESS && level >= BT_SECURITY_L3 ? 1 : 0);
	k_sem_give(&ended);
}

static void on_disconnected(struct bt_conn *conn, uint8_t reason)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(reason);
	atomic_clear(&proved);
	k_sem_give(&ended);
}

BT_CONN_CB_DEFINE(link_security_callbacks) = {
	.connected = on_connected,
	.disconnected = on_disconnected,
	.security_changed = on_security,
};

static bool is_connected(struct bt_conn *conn)
{
	struct bt_conn_info info;

	return bt_conn_get_info(conn, &info) == 0 && info.state == BT_CONN_STATE_CONNECTED;
}

int link_security_wait(struct bt_conn *conn)
{
	int err = 0;

	/* The leader begins; the follower's host stack would start all over on its own request. */
	if (IS_ENABLED(CONFIG_BT_CENTRAL)) {
		err = bt_conn_set_security(conn, BT_SECURITY_L3);
	}
	if (!err && !link_security_is_proved()) {
		err = k_sem_take(&ended, PROOF_TIMEOUT);
	}
	if (link_security_is_proved()) {
		return 0;
	}
	/* Out of reach is nobody's fault. */
	if (!is_connected(conn)) {
		return -ENOTCONN;
	}
	atomic_inc(&refused);
	return err ? err : -EACCES;
}

bool link_security_is_proved(void)
{
	return atomic_get(&proved) != 0;
}

/* --- report ---------------------------------------------------------------------------------- */

void link_security_report(void)
{
	static uint32_t reported;
	const struct wire_link_security security = {
		.t_ticks_node = sync_timer_now_ticks(),
		.key = atomic_get(&key_is_stored) ? WIRE_LINK_KEY_ORIGIN_STORED
						  : WIRE_LINK_KEY_ORIGIN_IMAGE,
		.secure = link_security_is_proved() ? 1U : 0U,
		.refused = (uint32_t)atomic_get(&refused),
	};
	uint8_t payload[WIRE_LINK_SECURITY_SIZE];

	diag_uart_frame(WIRE_LINK_SECURITY_ID, payload, wire_link_security_put(payload, &security));
	if (security.refused != reported) {
		reported = security.refused;
		diag_report_fault(WIRE_FAULT_CODE_LINK_STRANGER, reported,
				  "a peer did not prove the link's key");
	}
}
