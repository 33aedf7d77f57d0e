// Philox 4x64 with 10 rounds (Salmon et al. 2011, doi:10.1145/2063384.2063405), for the bodies of native functions: the four words of
// a block (c0, 0, 0, c3) with a key (k0, k1).

typedef unsigned long long W;
const auto philox = [](W c0, W c3, W k0, W k1, W* words) {
  W c1 = 0, c2 = 0;
  for (int round = 0; round < 10; ++round) {
    const unsigned __int128 a = (unsigned __int128)0xD2E7470EE14C6C93ull * c0, b = (unsigned __int128)0xCA5A826395121157ull * c2;
    c0 = (W)(b >> 64) ^ c1 ^ k0;
    c1 = (W)b;
    c2 = (W)(a >> 64) ^ c3 ^ k1;
    c3 = (W)a;
    k0 += 0x9E3779B97F4A7C15ull;
    k1 += 0xBB67AE8584CAA73Bull;
  }
  words[0] = c0, words[1] = c1, words[2] = c2, words[3] = c3;
};
