/** Four drones on their circle around an object. The same drawing is the page's icon. */
export function Logo() {
  return (
    <svg className="logo" viewBox="3 3 26 26" aria-hidden="true" focusable="false">
      <circle className="logo-circle" cx="16" cy="16" r="9.5" />
      <path
        className="logo-object"
        d="M16 10.6 20.9 13.4v5.4L16 21.6l-4.9-2.8v-5.4z M11.1 13.4 16 16.2l4.9-2.8 M16 16.2v5.4"
      />
      <circle cx="16" cy="6.5" r="2.7" fill="#5aa9ff" />
      <circle cx="25.5" cy="16" r="2.7" fill="#f5b041" />
      <circle cx="16" cy="25.5" r="2.7" fill="#46c98b" />
      <circle cx="6.5" cy="16" r="2.7" fill="#d78bf0" />
    </svg>
  );
}
