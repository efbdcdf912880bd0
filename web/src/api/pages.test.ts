import { afterEach, describe, expect, it, vi } from "vitest";
import { nextPage, requestAll } from "./request";

/** Answer requests with pages of a list, each naming the next one. */
function serve(pages: readonly (readonly number[])[]): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", (url: string) => {
    const page = asked.push(url) - 1;
    const link = page + 1 < pages.length ? { Link: `</api/v1/things?cursor=c${page}>; rel="next"` } : {};
    return Promise.resolve(new Response(JSON.stringify(pages[page] ?? []), { headers: link as HeadersInit }));
  });
  return asked;
}

describe("requestAll", () => {
  afterEach(() => {
    vi.unstubAllGlobals();
  });

  it("joins all pages in their order", async () => {
    const asked = serve([[1, 2], [3], [4, 5]]);
    expect(await requestAll("/things?state=running")).toEqual([1, 2, 3, 4, 5]);
    expect(asked.map((url) => url.slice(url.indexOf("/things")))).toEqual([
      "/things?state=running",
      "/things?cursor=c0",
      "/things?cursor=c1",
    ]);
  });

  it("gives up on a list without an end", async () => {
    const endless = new Proxy<number[][]>([], { get: (_, key) => (key === "length" ? Infinity : [1]) });
    serve(endless);
    await expect(requestAll("/things")).rejects.toThrow("no end");
  });
});

describe("nextPage", () => {
  it.each([
    [null, null],
    ['</api/v1/things?cursor=a&limit=2>; rel="next"', "/things?cursor=a&limit=2"],
    ["</drones/api/v1/things?cursor=a>; rel=next", "/things?cursor=a"],
    ['</api/v1/things?cursor=a>; rel="prev"', null],
  ])("of %j is %j", (link, path) => {
    expect(nextPage("/things", link)).toBe(path);
  });
});
