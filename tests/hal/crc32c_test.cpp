#include "hal/crc32c.hpp"

#include <numeric>
#include <string_view>

#include "tests/support/catch.hpp"

using saltus::crc32c;

TEST_CASE("CRC-32C gives the values of RFC 3720, appendix B.4, and the check value of the catalogues") {
  std::array<std::uint8_t, 32> bytes{};
  CHECK(crc32c(bytes) == 0x8A9136AA);
  bytes.fill(0xFF);
  CHECK(crc32c(bytes) == 0x62A8AB43);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  CHECK(crc32c(bytes) == 0x46DD794E);
  const std::array<std::uint8_t, 9> digits{'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  CHECK(crc32c(digits) == 0xE3069283);
  CHECK(crc32c({}) == 0);
}
