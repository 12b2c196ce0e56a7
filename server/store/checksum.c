/**
 * checksum.c: a sum of bytes as 64-bit words.
 *
 * A step maps (sum, word) to mix(sum ^ word), where mix is one to one: a product with an odd number can be
 * undone, and so can the addition, without carries, of a number's own high bits to its low ones. So words that
 * differ in one place give sums that differ from there on, to the end. A product carries upwards only; the
 * shifts bring what has changed above back down, twice, so that no few bits of the next word make up for it.
 */
#include "checksum.h"

#include <endian.h>
#include <string.h>

static uint64_t add(uint64_t sum, uint64_t word)
{
    sum ^= le64toh(word);
    sum *= UINT64_C(0x9e3779b97f4a7c15); /* 2^64 divided by the golden ratio, odd */
    sum ^= sum >> 32;
    sum *= UINT64_C(0xda942042e4dd58b5); /* odd, with bits all over */
    return sum ^ sum >> 29;
}

uint64_t qm_checksum(const void *bytes, size_t size, uint64_t seed)
{
    const uint8_t *next = bytes;
    uint64_t sum = add(add(0, htole64(seed)), htole64(size)), word;
    for (; size >= sizeof word; size -= sizeof word, next += sizeof word) {
        memcpy(&word, next, sizeof word);
        sum = add(sum, word);
    }
    word = 0;
    memcpy(&word, next, size);
    return add(sum, word);
}
