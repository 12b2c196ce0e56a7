/**
 * notify.h: tells systemd that the daemon is ready or stops (sd_notify(3): one datagram to the socket that
 * NOTIFY_SOCKET names). The protocol is a promise of systemd, and small enough not to need its library.
 */
#ifndef QM_NOTIFY_H
#define QM_NOTIFY_H

/** Sends a state such as "READY=1"; does nothing when no service manager has asked for it. */
void qm_notify_send(const char *state);

#endif
