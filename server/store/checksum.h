/**
 * checksum.h: 64 bits that tell whether stored bytes are those that were written. A guard against disks, not
 * against somebody who writes to the data folder.
 */
#ifndef QM_CHECKSUM_H
#define QM_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/**
 * The sum of some bytes; the seed says where they belong. Bytes of one length that differ within one word of
 * eight bytes have different sums, certainly; others but for one in 2^64.
 */
uint64_t qm_checksum(const void *bytes, size_t size, uint64_t seed);

#endif
